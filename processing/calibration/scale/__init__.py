"""From relative pictures to cd/m2: meter, white board, chart, vignetting, glare."""
