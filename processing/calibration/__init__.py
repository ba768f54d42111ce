"""From brackets and one meter reading to pictures in cd/m2: pure numeric modules, no files."""
