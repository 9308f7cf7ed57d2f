"""Long work: run in parallel, stored, resumed."""
