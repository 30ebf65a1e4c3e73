"""Luminance of linear RGB with the primaries of BT.709, which are sRGB's, and the white of D65."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue (ITU-R BT.709-6, 3.2)."""
