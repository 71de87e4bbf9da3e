"""The only compiled code: arrays in, arrays and a status out. No Python objects, no fastmath."""
