"""A folder that another program writes: any logger or controller that can write files and rename them."""
