"""theta_z1"""
