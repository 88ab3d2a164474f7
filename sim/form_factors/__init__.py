"""Form factors F[i, j]: the share of the power leaving patch i that reaches patch j."""

from sim.form_factors.factors import FormFactors, form_factors

__all__ = ["FormFactors", "form_factors"]
