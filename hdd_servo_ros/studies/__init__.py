"""Studies: one module per figure, table or tuning run that the documentation shows."""
