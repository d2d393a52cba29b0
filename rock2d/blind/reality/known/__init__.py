"""The known effects in the reality engine."""
