"""The paper's tables and figures, `command.reproduce` computes and draws all of them."""
