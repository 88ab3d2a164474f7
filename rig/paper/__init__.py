"""The experiments of Dehos et al. 2014 again."""
