"""Quick pictures of furniture for catalogues: soft light and shadow, no bounced light; not the rendering stage."""
