"""The paper's tables and figures, one module each; `reproduction.write_all` makes them all."""
