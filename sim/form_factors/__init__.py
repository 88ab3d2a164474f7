"""Form factors F[i, j]: the share of the power leaving patch i that reaches patch j."""

from sim.form_factors.factors import ClosureWarning, FormFactors, form_factors

__all__ = ["ClosureWarning", "FormFactors", "form_factors"]
