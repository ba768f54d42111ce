"""Real furnished rooms, end to end: rules that a program can check, and grades given by looking."""
