"""What Python programs use: thin functions over the rooms, and results that show themselves."""
