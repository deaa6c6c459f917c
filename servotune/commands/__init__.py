"""The commands of `servotune` that speak to a service, one file for each thing that is done."""
