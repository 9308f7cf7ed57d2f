from .pictures import glyphs as glyphs
