"""The public Python interface: thin functions over the rooms, and results with tables, plots and pages."""
