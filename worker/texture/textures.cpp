#include "texture/textures.h"
