"""What the gantry driver is made of: axes, codes, and one wire per firmware family."""
