"""The page of `nablahog app`: see a HOG, watch its pre-image grow, turn a model until it fits; and its JSON API."""
