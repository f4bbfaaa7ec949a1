"""The sensor on a real or a virtual bench: streams in, poses out, the beam following the mirror."""
