"""The paper's tables and figures, one module each; `command.reproduce` computes and draws all of them."""
