"""Methods that depthprint is measured against, one file each."""
