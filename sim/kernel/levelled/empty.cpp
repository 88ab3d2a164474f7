#include "level.hpp"
