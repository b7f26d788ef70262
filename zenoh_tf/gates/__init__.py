"""Gates hold items until their transforms exist: `gate` is what users have, `queue` decides."""
