"""Results on paper: statistics of returns, numbers in words, tables, a style for plots, JSON."""
