"""Whatever people pass, as what the package computes with: a module for each kind of thing, and one sentence if not."""
