"""Step 8: figures and tables; every picture is a function here, results hold no plotting."""
