"""Showing and looking by hand: one picture held on a projector, one photograph with figures."""
