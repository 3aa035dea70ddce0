"""Statistics of returns, the purpose of seeds, numbers and tables as text, the style of plots, JSON."""
