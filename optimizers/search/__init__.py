"""What methods are made of: descents, clouds, fronts, maps, budgets, reports."""
