"""Proofs: upper bounds of the privacy of every decision within a budget, and the search that reaches them."""
