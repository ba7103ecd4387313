"""One file for each figure, table or tuning run that the documents show."""
