"""The tables of the paper: what each needs is run, summarised, compared and written."""
