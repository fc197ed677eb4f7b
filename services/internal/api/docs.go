package api

import (
	"bytes"
	"html/template"
	"maps"
	"net/http"
	"slices"
	"strings"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
)

// docsTemplate is plain HTML: no script, and nothing from elsewhere.
const docsTemplate = `<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{.Title}}: REST interface</title>
<link rel="stylesheet" href="/docs.css">
<main>
<h1>{{.Title}}: REST interface</h1>
<p>{{.Description}} The whole description for tools: <a href="/openapi.json">/openapi.json</a> (OpenAPI 3.1).</p>
{{range .Operations}}
<section id="{{.ID}}">
<h2><code>{{.Method}} {{.Path}}</code></h2>
<p>{{.Summary}}. {{.Description}}</p>
<p>Needs: {{.Role}}</p>
{{if .Parameters}}<table><tr><th>Parameter</th><th>In</th><th>Meaning</th></tr>
{{range .Parameters}}<tr><td><code>{{.Name}}</code></td><td>{{.In}}</td><td>{{.Description}}</td></tr>{{end}}
</table>{{end}}
{{if .Body}}<p>Body: {{.Body}}</p>{{end}}
<p>Answers: {{.Answers}}</p>
</section>
{{end}}
<h2>Objects</h2>
{{range .Schemas}}
<section id="schema-{{.Name}}"><h3>{{.Name}}</h3>
<table><tr><th>Field</th><th>Type</th><th>Meaning</th></tr>
{{range .Fields}}<tr><td><code>{{.Name}}</code></td><td>{{.In}}</td><td>{{.Description}}</td></tr>{{end}}
</table></section>
{{end}}
</main>
</html>
`

type docsOperation struct {
	ID, Method, Path, Summary, Description, Role string
	Parameters                                   []docsField
	Body, Answers                                string
}

type docsField struct{ Name, In, Description string }

type docsSchema struct {
	Name   string
	Fields []docsField
}

// docsPage renders the OpenAPI document for reading.
func docsPage(document *huma.OpenAPI) http.Handler {
	page := struct {
		Title, Description string
		Operations         []docsOperation
		Schemas            []docsSchema
	}{document.Info.Title, document.Info.Description, docsOperations(document), docsSchemas(document)}
	var buffer bytes.Buffer
	if err := template.Must(template.New("docs").Parse(docsTemplate)).Execute(&buffer, page); err != nil {
		panic(err) // template and data are both ours
	}
	return http.HandlerFunc(func(w http.ResponseWriter, _ *http.Request) {
		w.Header().Set("Content-Type", "text/html; charset=utf-8")
		_, _ = w.Write(buffer.Bytes()) // a client that has left is not our problem
	})
}

func docsOperations(document *huma.OpenAPI) []docsOperation {
	var operations []docsOperation
	for _, path := range slices.Sorted(maps.Keys(document.Paths)) {
		item := document.Paths[path]
		for _, operation := range []*huma.Operation{item.Get, item.Post, item.Delete} {
			if operation != nil {
				operations = append(operations, describe(operation))
			}
		}
	}
	return operations
}

func describe(operation *huma.Operation) docsOperation {
	described := docsOperation{
		ID: operation.OperationID, Method: operation.Method, Path: operation.Path,
		Summary: operation.Summary, Description: operation.Description,
		Role: "nothing", Answers: strings.Join(slices.Sorted(maps.Keys(operation.Responses)), ", "),
	}
	if role, err := roleOf(operation); err == nil && role != auth.None {
		described.Role = "the role " + role.String()
	}
	for _, parameter := range operation.Parameters {
		described.Parameters = append(described.Parameters,
			docsField{parameter.Name, parameter.In, parameter.Description})
	}
	if operation.RequestBody != nil {
		described.Body = strings.Join(slices.Sorted(maps.Keys(operation.RequestBody.Content)), ", ")
	}
	return described
}

func docsSchemas(document *huma.OpenAPI) []docsSchema {
	var schemas []docsSchema
	all := document.Components.Schemas.Map()
	for _, name := range slices.Sorted(maps.Keys(all)) {
		schema := docsSchema{Name: name}
		for _, field := range slices.Sorted(maps.Keys(all[name].Properties)) {
			property := all[name].Properties[field]
			schema.Fields = append(schema.Fields, docsField{field, typeName(property), property.Description})
		}
		schemas = append(schemas, schema)
	}
	return schemas
}

func typeName(schema *huma.Schema) string {
	switch {
	case schema.Ref != "":
		return schema.Ref[strings.LastIndex(schema.Ref, "/")+1:]
	case schema.Type == huma.TypeArray && schema.Items != nil:
		return typeName(schema.Items) + "[]"
	case len(schema.OneOf) > 0:
		var names []string
		for _, one := range schema.OneOf {
			names = append(names, typeName(one))
		}
		return strings.Join(names, " or ")
	default:
		return schema.Type
	}
}
