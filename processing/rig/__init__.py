"""From rig sessions (a chart, a flat field, a filter) to the rig's calibration profile."""
