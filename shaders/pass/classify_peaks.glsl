// Peak finding.

#if METHOD == 2
void composite_peaks(Stretch stretch) { }
#endif
