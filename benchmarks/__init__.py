"""Programs that measure. Never imported by the package, never asserted on."""
