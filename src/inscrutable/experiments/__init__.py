"""Experiments: sequences of decisions, comparisons, backtests, audits and studies."""
