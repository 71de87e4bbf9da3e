"""FAB-MAP 2.0 on depth or camera images: the appearance-only rival of the paper's loop-closure experiment."""
