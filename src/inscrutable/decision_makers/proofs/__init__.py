"""Proofs: upper bounds of the privacy of every decision within a budget."""
