"""Survey targets in scans: spheres, black-and-white boards, retro-reflective squares and cylinders."""
