// Pre-integration by a table of two values (and a length).

#if METHOD == 1 && INTEGRATION > 0
void composite_entry(Stretch stretch) { }
#endif
