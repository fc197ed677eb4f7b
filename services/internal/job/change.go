package job

import (
	"encoding/json"
	"maps"
	"slices"
)

// Change is what a user changes about a job after its submission; nil leaves a property as it is.
type Change struct {
	// Name as in Request; empty asks for the default.
	Name *string
	// Priority as in Request.
	Priority *int
}

// ParseChange reads the members of a JSON merge patch (RFC 7396): null asks for the default. Its errors
// are *FieldError.
func ParseChange(patch map[string]json.RawMessage) (Change, error) {
	var change Change
	for _, field := range slices.Sorted(maps.Keys(patch)) {
		var err error
		switch field {
		case "name":
			change.Name, err = member[string](field, "text", patch[field])
		case "priority":
			change.Priority, err = member[int](field, "a whole number", patch[field])
		default:
			err = invalid(field, "cannot be changed once a job is submitted; name and priority can")
		}
		if err != nil {
			return Change{}, err
		}
	}
	return change, change.validate()
}

// member decodes a value; null becomes the zero value.
func member[T any](field, kind string, value json.RawMessage) (*T, error) {
	decoded := new(T)
	if err := json.Unmarshal(value, decoded); err != nil {
		return nil, invalid(field, "is %s; want %s, or null for the default", value, kind)
	}
	return decoded, nil
}

func (c *Change) validate() error {
	if c.Name != nil {
		if err := validateName(*c.Name); err != nil {
			return err
		}
	}
	if c.Priority != nil {
		return validatePriority(*c.Priority)
	}
	return nil
}

// Apply changes a request, whose name is then set.
func (c *Change) Apply(r *Request) {
	if c.Name != nil {
		r.Name = *c.Name
		r.SetDefaultName()
	}
	if c.Priority != nil {
		r.Priority = *c.Priority
	}
}
