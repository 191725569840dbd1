"""The sequential rule, step by step: it decides by the observer's law of the belief."""
