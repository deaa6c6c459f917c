"""The peers at the pneumatic loop, one file each, used as their documentation shows; each imports its library when made."""
