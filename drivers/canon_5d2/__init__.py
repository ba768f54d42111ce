"""canon_5d2"""
