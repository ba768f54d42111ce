"""outdoor"""
