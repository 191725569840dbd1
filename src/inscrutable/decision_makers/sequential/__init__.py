"""The decision maker that keeps account of what the observer already holds, step by step."""
