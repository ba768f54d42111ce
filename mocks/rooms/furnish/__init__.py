"""furnish"""
