"""Headless OpenGL: context, shader sources, programs and memory layouts."""
