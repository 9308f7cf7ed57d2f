"""From arguments to images, descriptors, specs, templates and priors."""
