"""What each entry point does with each kind of input: a table whose rows are inputs and whose columns are functions."""
