#include "image_io/read_image.h"
