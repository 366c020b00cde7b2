"""Where the control core runs: in this process, or on a board behind a serial line."""
