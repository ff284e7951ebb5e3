"""The picture: camera, scene, A-buffer, image."""
