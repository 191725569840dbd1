"""The search for the most private decisions over critical regions, for many beliefs at once."""
