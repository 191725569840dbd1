"""The sequential rule: each step depends on the observer's law of the belief."""
