#version 450 core
// Measure pass: writes nothing; an occlusion query around it counts the fragments of the picture.

void main() {}
