"""Published models: made from finished runs, verified, told of. The command is models.zoo."""
