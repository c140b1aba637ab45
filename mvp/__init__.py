"""Planning core and cell runtime of mvp-cell. Knows protocols, never a vendor."""
