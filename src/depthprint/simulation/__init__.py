"""The simulated world: made here, ray cast, and always called simulated."""
