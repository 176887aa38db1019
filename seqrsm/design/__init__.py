"""Factors, the region they span, the quadratic model, and the designs that estimate it."""
