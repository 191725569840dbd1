"""Reports: figures, tables and pages of results; all plotting is here."""
