#include "texture/images.h"
