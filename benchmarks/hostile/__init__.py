"""Figures in worlds that share no model with the estimators."""
