"""The known effects in the reality engine, one file each, in forms that differ from those of the toolkit."""
