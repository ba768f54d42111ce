"""Figures in worlds that share no code with the estimators."""
