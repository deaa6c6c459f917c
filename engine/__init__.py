"""What a dynamic system is and does: diagrams, exact responses, metrics, influence. Pure numerics in SI units."""
