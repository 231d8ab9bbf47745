"""Published models: made from finished runs, verified, described. The command is models.zoo."""
