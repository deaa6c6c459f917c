"""What identifications start from: recordings and measured frequency responses, and what is wrong with them."""
