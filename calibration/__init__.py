"""Estimators and wizards that fit the result models of ``mvp.calibrated``."""
