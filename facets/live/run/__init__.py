"""From blocks of bytes to poses: the loop, the solving, and what is shown of them."""
