"""Results for people: the session report, figures, tables."""
