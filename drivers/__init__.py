"""First-party driver plugins, one file each. Loaded by key through entry points."""
