"""The cascade detector: vectors propose, the exact NCD ranks, geometry and neighbouring frames decide.

The way of a query, from codes to answer::

    fused_recognizer        vectors with a shift search, thumbnails, relaxed bounds, exact distances
      -> proposals          neighbouring frames see one place, and are one proposal
      -> checked_query      which places geometry checks; checked_places: what it said of them
      -> verified_recognizer  the same around any method
    assembly                all of it, with the stages that settings turn on
"""
