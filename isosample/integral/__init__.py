"""Float64 twins of the shader library, and the mathematics behind them."""
