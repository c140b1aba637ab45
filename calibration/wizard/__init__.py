"""Wizards: calibrations that a person, or nobody, can carry out to the end."""
