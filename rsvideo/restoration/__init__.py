"""Physics and solvers together: from one blurred frame to its trajectory and its latent image."""
