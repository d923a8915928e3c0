"""Strips of airborne laser scans, corrected together by what they see in common (Kager, VGI 4/2003; MATH 12)."""
