"""The methods that the paper compares with in Table 1, each in one file."""
