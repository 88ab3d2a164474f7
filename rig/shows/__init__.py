"""Shows that run for months: saved in a file, on at their times, started again whatever ends them."""
