package client

import (
	"bufio"
	"context"
	"encoding/json"
	"fmt"
	"io"
	"net/http"
	"strconv"
	"strings"

	"metrofarm/services/internal/job"
)

// Events opens the event stream of a job, after the event with the given sequence. All events come
// through the channel, past ones first; it is closed when ctx or the connection ends.
func (c *Client) Events(ctx context.Context, id string, after uint64) ([]job.Event, <-chan job.Event, error) {
	header := http.Header{"Last-Event-Id": {strconv.FormatUint(after, 10)}}
	response, err := c.do(ctx, http.MethodGet, jobPath(id, "/events"), nil, header)
	if err != nil {
		return nil, nil, err
	}
	if !strings.HasPrefix(response.Header.Get("Content-Type"), "text/event-stream") {
		response.Body.Close()
		return nil, nil, errNoStream
	}
	events := make(chan job.Event)
	go func() {
		defer close(events)
		defer response.Body.Close()
		// Whatever ended the stream, the reader of the channel connects again.
		_ = readEvents(response.Body, func(event job.Event) error {
			select {
			case events <- event:
				return nil
			case <-ctx.Done():
				return ctx.Err()
			}
		})
	}()
	return nil, events, nil
}

// readEvents parses server-sent events. Of their fields only data matters: it repeats the others.
func readEvents(r io.Reader, emit func(job.Event) error) error {
	reader := bufio.NewReader(r)
	var data strings.Builder
	for {
		line, err := reader.ReadString('\n')
		if err != nil {
			return err
		}
		line = strings.TrimRight(line, "\r\n")
		if text, found := strings.CutPrefix(line, "data:"); found {
			data.WriteString(strings.TrimPrefix(text, " "))
		}
		if line != "" || data.Len() == 0 {
			continue
		}
		var event job.Event
		if err := json.Unmarshal([]byte(data.String()), &event); err != nil {
			return fmt.Errorf("event: %w", err)
		}
		data.Reset()
		if err := emit(event); err != nil {
			return err
		}
	}
}
