"""Everything around a method: ranges, yield, neighbours, parts for several processes."""
