"""Naming objects: what their views are compared by, the fused recogniser, its file, and the methods of the table.

The way of a view, from crop to class::

    surface_words                   vectors of its surfaces, beside the codes and the pairs of points
      -> kernels, distances         how views compare; comparisons, surface_comparisons: all of a table's
      -> fused_recogniser           discriminant, support vector machine and nearest views, summed
      -> alignment                  the best few stored views, aligned with the query
      -> calibration                a probability, "none of these" among the outcomes
"""
