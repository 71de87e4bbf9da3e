"""Comparisons of depthprint's engine with the packages that others would use, all timed in one run."""
