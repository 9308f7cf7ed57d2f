"""The page of `nablahog app` and its API."""
