"""Proofs: upper bounds on what anybody could hide within a budget, and the search that closes on them."""
