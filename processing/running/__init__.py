"""How the stages of the table are run: what has to, each result whole or not at all, and why."""
