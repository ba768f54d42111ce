"""Cameras whose families the estimators do not know: real curves, mosaics, processing, stray and moving light."""
