"""Byte-level far ends of the wires. They share no codec with the drivers."""
