"""Kernel descriptors of depth (gradient, LBP, spin, size) with efficient match kernels and a linear SVM."""
