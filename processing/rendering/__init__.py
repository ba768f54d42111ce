"""Albedo from the calibrated picture, and the staged room rendered under the measured light, in cd/m2."""
