"""The only readers of the simulated truth: scores of a session, and the true light transport."""
